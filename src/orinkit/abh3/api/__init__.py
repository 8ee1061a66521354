"""The API of ABH3 drivers."""
