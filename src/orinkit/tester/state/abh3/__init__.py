"""The state of the page ABH3: driving, parameters, and the explanation of frames."""
