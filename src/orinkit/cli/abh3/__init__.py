"""``orinkit abh3``: ABH3 motor drivers on CAN buses."""
