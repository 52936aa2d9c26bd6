"""What builds the library of compiled code; numba is known here alone, and nothing here is imported to use a library.

``options``: the compiler's settings; ``lanes``, ``views``: its types for numbers in lanes and for arguments;
``frontend``: kernels become its intermediate representation; ``emission``: that becomes a shared object; ``parts``:
what is compiled together.
"""
