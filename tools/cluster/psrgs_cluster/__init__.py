"""Trains the blocks of a psrgs-vk plan on many machines, by Ray. README.md says how."""
