"""How the loop gets fast: compiled natively, batches, threads, gradients, arithmetic written out."""
