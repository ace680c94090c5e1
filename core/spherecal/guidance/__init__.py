"""Where to put the ball next: what stopping now would give, and what every further placement would."""
