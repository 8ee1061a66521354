"""What the virtual controllers' arms have in common: control loop, motion, servo, set-point buffer."""
