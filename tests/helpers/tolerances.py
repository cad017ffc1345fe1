"""The one table of tolerances of the block and truth tests, each with its reason.

Loosening one to make a test pass is a defect: find out what differs, or write it into KNOWN_GAPS.md.
All are relative to the size of what is compared (the largest entry of the row), in float64.
"""

EPS = 2.220446049250313e-16

# The same arithmetic, compiled: XLA may contract a*b+c into one rounding and reorder sums, a few units in the last
# place per operation; blocks have up to about a hundred operations.
JIT_IS_EAGER = 1e-13

# The same, over 40 steps of a loop whose feedback multiplies a rounding by the loop's condition (about 100).
JIT_IS_EAGER_IN_A_LOOP = 1e-11

# A batch is the same program with another vectorisation of tanh, exp and log (a few units in the last place).
VMAP_IS_LOOP = 1e-13
VMAP_IS_LOOP_IN_A_LOOP = 1e-11

# Forward and reverse mode differ only in the order of the sums of the chain rule.
REVERSE_IS_FORWARD = 1e-12
REVERSE_IS_FORWARD_IN_A_LOOP = 1e-9

# A central difference with step h = eps^(1/3) x the variable's own scale errs by about h^2 f'''/6 + eps f/h, both about
# eps^(2/3) = 4e-11 of f/scale. Third derivatives in units of the scale reach some tens (tanh, exp(-x^2)), and rows mix
# terms whose sizes differ by a thousand: a factor of 250.
FINITE_DIFFERENCE = 1e-8

# In a loop the value is a sum over steps whose own rounding (1e-13) is divided by h = 6e-6, and the third derivative
# along a trajectory of tens of reversals is larger: eps^(2/3) x 2e4.
FINITE_DIFFERENCE_IN_A_LOOP = 1e-6
DIFFERENCE_STEP = EPS ** (1.0 / 3.0)
