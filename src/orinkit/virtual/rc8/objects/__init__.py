"""The CAO objects of the virtual RC8 that clients use."""
