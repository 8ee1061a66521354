"""VARIANT values and poses: types, binary encoding, text."""
