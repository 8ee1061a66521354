"""Raw Packet Mode (RC8 5.2): the parameters as form fields, the link of a page, and the text with packets."""
