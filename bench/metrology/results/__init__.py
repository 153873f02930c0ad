"""Results: findings with their budgets, limits, equations. Standard library only."""
