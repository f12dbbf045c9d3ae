"""An example of how to roll: a pass at one speed, as URScript and as a joint trajectory."""
