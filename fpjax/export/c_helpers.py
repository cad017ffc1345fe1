"""The few functions that C lacks: maximum, minimum and sign as jax defines them, and the bits of a number."""

from .operations import C_TYPES

# C99's fmax returns the number where one argument is NaN; jax returns NaN. `a != a` is true for NaN only, so these
# two return NaN for a NaN in either argument, and `sign` returns the NaN itself.
_FLOAT_HELPERS = {
    "largest": """\
static inline {t} largest_{t}({t} a, {t} b) /* not a number where one of them is not */
{{
    return a > b || a != a ? a : b;
}}
""",
    "smallest": """\
static inline {t} smallest_{t}({t} a, {t} b)
{{
    return a < b || a != a ? a : b;
}}
""",
    "sign": """\
static inline {t} sign_{t}({t} a)
{{
    return a > {zero} ? {one} : a < {zero} ? -{one} : a;
}}
""",
}
_INTEGER_HELPERS = {
    "largest": "static inline {t} largest_{t}({t} a, {t} b)\n{{\n    return a > b ? a : b;\n}}\n",
    "smallest": "static inline {t} smallest_{t}({t} a, {t} b)\n{{\n    return a < b ? a : b;\n}}\n",
}
# memcpy is the only way to reinterpret bits that C99 allows; compilers turn it into a register move.
_BITS = """\
static inline {t} bits_{t}({other} a)
{{
    {t} b;
    memcpy(&b, &a, sizeof b);
    return b;
}}
"""
# A float outside the integer's range is undefined behaviour in C; jax clips it to the range and turns NaN into 0.
_WHOLE = """\
static inline {t} whole_{t}({other} a) /* towards zero, held within the range */
{{
    return a != a ? 0 : a <= {low} ? {least} : a >= {high} ? {most} : ({t})a;
}}
"""
_SAME_SIZE = {"float64": "int64", "int64": "float64", "float32": "int32", "int32": "float32"}
_RANGE = {
    "int32": ("-2147483648.0", "(-INT32_C(2147483647) - 1)", "2147483648.0", "INT32_C(2147483647)"),
    "int64": (
        "-9223372036854775808.0", "(-INT64_C(9223372036854775807) - 1)", "9223372036854775808.0",
        "INT64_C(9223372036854775807)",
    ),
}  # fmt: skip


def helper_text(wanted: set[tuple[str, str]], real: str) -> str:
    """The helpers' C.

    Args:
        wanted: (helper, kind of its result).
        real: the law's own type.
    """
    parts = []
    for name, kind in sorted(wanted):
        single = kind == "float32"
        words = {"t": C_TYPES[kind], "zero": "0.0f" if single else "0.0", "one": "1.0f" if single else "1.0"}
        if name == "bits":
            parts.append(_BITS.format(**words, other=C_TYPES[_SAME_SIZE[kind]]))
        elif name == "whole":
            ends = [each + ("f" if real == "float" and "." in each else "") for each in _RANGE[kind]]
            low, least, high, most = ends
            parts.append(_WHOLE.format(**words, other=real, low=low, least=least, high=high, most=most))
        elif kind in ("float32", "float64"):
            parts.append(_FLOAT_HELPERS[name].format(**words))
        else:
            parts.append(_INTEGER_HELPERS[name].format(**words))
    return "\n".join(parts)
