"""Elements of the user interface that several pages share: the frame of a page, errors, inputs."""
