"""List the serial adapters of the machine and the problems that prevent access to them."""
