"""ABH3 motor drivers as a CAO provider, ``CaoProv.Waco.ABH3``."""
