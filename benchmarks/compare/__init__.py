"""Algorithm 1, its repaired variant, a dense sweep, gradients and Nelder-Mead, at the same objective and budget."""
