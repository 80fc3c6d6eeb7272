"""A device on a port: protocol, handshake, source; and virtual ones."""
