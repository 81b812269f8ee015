"""The solver as C sources, for a controller in C or C++ that has no Python."""
