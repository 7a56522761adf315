"""The commands of `twin`, one file each: arguments and printing only."""
