"""The public interface: what the commands do, as functions that return values.

`import twin` offers these names without importing anything heavy; defaults are those of the commands. What cannot be
used raises `twin.InputError`, whose message names the file, line or field and what would be right.
"""
