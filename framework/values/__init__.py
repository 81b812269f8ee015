"""Values that travel between the parts: frozen, validated once, in SI units."""
