"""The arm of a connection, without the browser: live state, jogging, stored poses, and the pendant."""
