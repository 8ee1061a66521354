"""The robot of the virtual RC8: its arm, the conditions of its functions, its commands and its feedback."""
