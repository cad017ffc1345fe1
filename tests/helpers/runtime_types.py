"""The check of types at run time: beartype with Python's own rule that an int may stand for a float (PEP 484).

For `--jaxtyping-packages=fpjax.gap,runtime_types.checked` and jaxtyping's import hook. pyright has the same rule.
"""

from beartype import BeartypeConf, beartype

checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
