"""Rate tables behind an Acutronic Acutrol3000 controller, in its command language ACL over TCP."""
