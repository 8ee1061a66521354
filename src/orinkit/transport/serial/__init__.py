"""Serial ports for clients."""
