"""The state of the Tester, shared by all pages: connections, packets, motions, controls. No user interface."""
