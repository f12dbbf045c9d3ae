"""Models of the cell's devices: they speak what the devices speak, byte for byte."""
