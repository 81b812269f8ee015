"""The pieces of the structured interior-point solver."""
