"""Speed against error: what each method and setting costs and what it gives for it."""
