"""A rig's parameters identified from its recordings: one file per laboratory procedure, and one joint estimate."""
