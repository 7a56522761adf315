"""A rig identified from its recordings, as a laboratory would: one procedure a file, and one joint estimate."""
