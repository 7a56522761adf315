"""A virtual rig: recordings of a planar flexible manipulator that do not come from the twin.

The twin is tested and shown on recordings. If its own simulation made them, an error in its equations would
be in the recordings too and nobody would see it. This corner therefore shares no model code with the twin:
the link is a geometrically exact beam in a Ritz basis (`beam`), integrated by an adaptive Dormand-Prince
pair with located stick and slip events (`plant`), driven and measured by its own drive and sensors
(`experiments`, `sensors`). Effects are switched on by the names of the vocabulary (`effects`), and a campaign
is written as a folder of CSV files with a `campaign.toml` (`campaign_writer`).

    python -m twin.virtual_rig OUT --effect viscous-friction:viscous=0.003 --seed 7
"""

from twin.virtual_rig.campaign_writer import Truth, make_campaign
from twin.virtual_rig.effects import EFFECTS, OUTSIDE_EFFECTS
from twin.virtual_rig.rig import UNCERTAINTY, Rig
from twin.virtual_rig.sensors import Sensors

__all__ = ["EFFECTS", "OUTSIDE_EFFECTS", "UNCERTAINTY", "Rig", "Sensors", "Truth", "make_campaign"]
