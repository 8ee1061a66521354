"""Slave mode from the client's side: an arm that is moved set-point by set-point, from a process of its own (RC8 4)."""
