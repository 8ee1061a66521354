"""Raw packets: hex text to packets, and links that carry any bytes (RC8 5.2, Raw Packet Mode)."""
