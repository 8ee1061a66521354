"""Variables of the virtual RC8: types, values, database."""
