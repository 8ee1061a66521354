"""Client side of slave mode: a separate process moves the arm set-point by set-point (RC8 4)."""
