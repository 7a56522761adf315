"""The commands of `twin`, one module each: arguments and printing only."""
