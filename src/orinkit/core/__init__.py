"""Return codes, exceptions, languages, logging: what everything else builds on."""
