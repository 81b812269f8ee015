"""How plans are judged beside their cost: by the contact that they are to expect."""
