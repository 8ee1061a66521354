"""TCP and UDP for clients."""
