"""Kernels and the library that they are compiled into; the compiler itself is known in ``builder`` and nowhere else.

``kernels``: functions that are compiled, and entries, which Python calls; ``arguments``: how arrays and numbers are
handed to them; ``library``: what is loaded; ``workspace``: named arrays in memory that is made once; ``lanes``: eight
numbers as one, the vector registers' kind of number; ``linalg``, ``angles``: small linear algebra, sines and cosines
that are refreshed; ``threads``: how many may run; ``builder``: what builds the library.
"""
