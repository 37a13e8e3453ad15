"""The figure: its skeleton, its pose representations and the kernels that move it.

Frame everywhere: right-handed, Y up, metres, radians; at rest the figure faces +Z with its left at +X.
Quaternions are (x, y, z, w); the product ``mul(b, a)`` applies ``a`` first.
"""
