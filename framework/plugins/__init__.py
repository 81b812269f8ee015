"""From a name to a plug-in: registry, configs, and the files that they are read from."""
