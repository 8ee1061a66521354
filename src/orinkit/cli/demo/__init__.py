"""``orinkit demo``: a client and a virtual controller talk, every packet explained."""
