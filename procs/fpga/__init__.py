"""Host side of the controllers: datagrams, registers, blocks, and conversion of bits to SI units."""
