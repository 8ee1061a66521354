"""The asynchronous API of ABH3, written by hand."""
