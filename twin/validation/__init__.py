"""Validation of a controller before it goes to hardware, by simulation on rigs drawn from the parameter uncertainty."""
