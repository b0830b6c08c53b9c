"""Time stepping: QP with given friction bound, fixed point, fallbacks, uniqueness, checkpoints."""
