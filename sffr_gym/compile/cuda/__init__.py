"""The CUDA thread as a kind of number: entries that step one environment in each thread of a GPU.

``described``: what an entry is given there; ``views``: the compiler's types for that; ``thread``: from an entry to PTX;
``program``: what is built, kept and loaded, and called.
"""
