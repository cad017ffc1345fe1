"""The nominal servo.toml of a case."""


def model_text(nominal: dict[str, float], gains: tuple[float, float], dt: float, with_position: bool) -> str:
    """The nominal servo.toml."""
    lines = [
        "[units]",
        'motion = "rotary"',
        'reference = "velocity"',
        f'sensors = "{"both" if with_position else "velocity"}"',
        "[plant]",
        'type = "one_mass"',
        f"inertia = {nominal['inertia']:.9g}",
        "[friction]",
        'type = "coulomb_viscous"',
        f"coulomb = {nominal['coulomb']:.9g}",
        f"viscous = {nominal['viscous']:.9g}",
    ]
    if nominal.get("offset", 0.0):
        lines.append(f"offset = {nominal['offset']:.9g}")
    if nominal.get("unbalance", 0.0):
        lines += [
            "[load]",
            'type = "unbalance"',
            f"amplitude = {nominal['unbalance']:.9g}",
            f"phase = {nominal['unbalance_phase']:.9g}",
        ]
    lines += [
        "[controller]",
        'type = "pi"',
        f"kp = {gains[0]:.9g}",
        f"ki = {gains[1]:.9g}",
        "[simulation]",
        f"dt = {dt:.9g}",
    ]
    return "\n".join(lines) + "\n"
