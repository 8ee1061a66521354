"""The CAO object model, common to all ORiN protocols: functions, base classes of devices, and sessions of clients."""
