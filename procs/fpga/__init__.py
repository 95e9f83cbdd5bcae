"""The controllers as a host sees them: datagrams, registers, blocks, and bits as SI units."""
