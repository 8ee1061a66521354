"""The protocol of ABH3 as data: identifiers, frames, signals, units."""
