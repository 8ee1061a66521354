"""What the page ABH3 does with a motor driver: driving, parameters, and the explanation of frames."""
