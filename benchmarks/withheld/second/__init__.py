"""The second truth: other laws, another integrator and other machines than `truth`; numpy only."""
