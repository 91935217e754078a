"""Implicit steps: solving x = z + c v, v = w + c M⁻¹ f(x, v) for v. Schemes differ in z, w and c alone."""
