"""The blocks that a loop is made of: the physics, and what measures and drives it."""
