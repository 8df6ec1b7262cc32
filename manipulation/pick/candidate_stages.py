"""The stages that a candidate passes, in this order: two of geometry and kinematics for the grasp, two for
the place, the cheapest first, and then what is planned."""

RANKED = "ranked"
HAND = "hand fits"
PRE_GRASP = "pre-grasp reached"
GRASP = "grasp reached"
ROOM = "room at the place"
PLACE = "place reached"
APPROACH = "approach planned"
TRANSFER = "transfer planned"
STAGES = (RANKED, HAND, PRE_GRASP, GRASP, ROOM, PLACE, APPROACH, TRANSFER)
