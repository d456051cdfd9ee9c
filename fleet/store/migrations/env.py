"""The environment in which Alembic runs the steps.

They run on the connection that `fleet.store.engine` passes, in its transaction.
"""

from __future__ import annotations

from alembic import context

context.configure(connection=context.config.attributes["connection"])
context.run_migrations()
