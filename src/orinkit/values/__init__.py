"""VARIANT values and poses: types, bytes, text."""
