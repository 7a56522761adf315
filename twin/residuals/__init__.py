"""What a model leaves unexplained of a recording, local in time: the measured hub angle drives the modelled link."""
