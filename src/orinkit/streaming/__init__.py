"""Client side of slave mode: a process of its own moves the arm set-point by set-point (RC8 4)."""
