"""What a result is: findings with their budgets, limits, equations. Standard library only."""
