"""Imitation methods, one file each, in the order and with the symbols of the paper."""
