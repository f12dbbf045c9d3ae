"""The paper's method: votes into disparity space images, fused by Bayesian model averaging."""
