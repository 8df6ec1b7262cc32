"""Robot of the physics backend: body, motors and devices."""
