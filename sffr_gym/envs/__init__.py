"""The Gymnasium environments of ``SFFRFlex-v0``. Its modules are imported by their names.

``single``, ``vector``: the two forms; ``batch``: the arrays that both advance; ``fleet``: their plants, packed.
"""
