"""The distribution: what wheel and sdist hold, and what describes them."""
