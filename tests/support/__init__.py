"""What tests of several folders share: devices, peers, clocks, cells, programs."""
