"""Return codes, exceptions, languages and logging: the foundation of all other packages."""
