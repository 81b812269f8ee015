"""The suite of asv: the work by which commits are compared."""
