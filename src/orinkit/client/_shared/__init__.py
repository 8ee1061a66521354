"""Plain data and functions of both clients."""
