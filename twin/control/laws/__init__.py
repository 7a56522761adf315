"""Control laws: the paper's two, shaped and friction-compensated variants of them, and those of a user's file."""
