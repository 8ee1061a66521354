"""``orinkit demo``: a client calls a virtual controller; every packet is explained."""
