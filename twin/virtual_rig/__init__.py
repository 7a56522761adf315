"""A virtual rig that generates recordings of a planar flexible manipulator independently of the twin.

If the twin's own simulation generated its test data, an error in its equations would be in the data too, and no test
would detect it. This package therefore shares no model code with the twin: the link is a geometrically exact beam in a
Ritz basis (`beam`), integrated by an adaptive Dormand-Prince pair with located stick and slip events (`plant`), with
its own drive and sensors (`experiments`, `sensors`). Effects are activated by the names of the twin's library
(`effects`), and a campaign is written as a folder of CSV files with a `campaign.toml` (`campaign_writer`).

    twin virtual-rig --out OUT --effect viscous-friction:viscous=0.003 --seed 7
"""

from twin.virtual_rig.campaign_writer import Truth, make_campaign
from twin.virtual_rig.effects import EFFECTS, OUTSIDE_EFFECTS
from twin.virtual_rig.rig import UNCERTAINTY, Rig
from twin.virtual_rig.sensors import Sensors

__all__ = ["EFFECTS", "OUTSIDE_EFFECTS", "UNCERTAINTY", "Rig", "Sensors", "Truth", "make_campaign"]
