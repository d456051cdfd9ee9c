"""Pages of a list: `limit` and `cursor` of a request, and the `Link` to the next page.

The link is as in RFC 8288.

A cursor holds the key of the last item of its page, and the next page begins behind that key. Items that are added
or deleted meanwhile therefore shift nothing: what exists all the time is on exactly one page. A cursor is opaque to
clients; it is not secret, and one that a client makes up selects another place in the same list.
"""

from __future__ import annotations

import base64
import operator
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import Depends, Query, Request
from starlette.datastructures import URL

from service.http.wire.problems import Problem
from service.http.work.stored_documents import readable

MOST = 500
Cursor = Annotated[
    str,
    Query(
        max_length=1000,
        description="Where the page begins, from the `Link` of the page before; at the beginning if empty.",
        examples=["L2FwaS92MS9ydW5zCjIwMjYxMTIxLTE3MDQ1OS0zZjlhMWMwN2IyZQ"],
    ),
]
Limit = Annotated[
    int,
    Query(ge=0, le=MOST, description="Number of items of a page, or 0 for all that are left.", examples=[50]),
]
Newest = Annotated[int, Query(ge=1, le=MOST, description="Number of them, newest first.", examples=[50])]
LINKED: dict[int | str, dict[str, Any]] = {
    200: {
        "headers": {
            "Link": {
                "description": 'The next page, `<PATH>; rel="next"` (RFC 8288), if `limit` or `cursor` was sent and '
                "more items are left.",
                "schema": {"type": "string"},
            }
        }
    }
}
"""The header of a page, for the `responses` of a route."""


@dataclass(frozen=True)
class ListPage:
    """Requested part of a list.

    Attributes
    ----------
    limit : int
        Number of items; 0 for all.
    after : str
        Key of the last item of the page before; empty for the first page.
    url : URL
        Address of the request.
    linked : bool
        Whether the answer links the next page: the request had `limit` or `cursor`.
    """

    limit: int
    after: str
    url: URL
    linked: bool

    def take(
        self,
        keys: Iterable[str],
        read: Callable[[str], dict[str, Any]],
        *,
        newest_first: bool = True,
    ) -> tuple[list[dict[str, Any]], str]:
        """Return the items of this page, and the key of the last one if more are left.

        Parameters
        ----------
        keys : iterable of str
            Keys of all items in the order of the list: descending, or ascending without `newest_first`.
        read : callable
            Returns the item of a key. Items that are damaged or gone are left out.
        """
        behind = operator.lt if newest_first else operator.gt
        items: list[dict[str, Any]] = []
        last = ""
        for key in keys:
            if self.after and not behind(key, self.after):
                continue
            if self.limit and len(items) == self.limit:
                return items, last
            items += readable((key,), read)
            last = key
        return items, ""

    def headers(self, last: str) -> dict[str, str]:
        """Return the headers of the answer with this page; `last` is the key that `take` returned."""
        if not last or not self.linked:
            return {}
        whole = self.url.include_query_params(cursor=_cursor(self.url.path, last))
        return {"Link": f'<{whole.path}?{whole.query}>; rel="next"'}


def _cursor(path: str, key: str) -> str:
    return base64.urlsafe_b64encode(f"{path}\n{key}".encode()).decode().rstrip("=")


def _page(request: Request, limit: int, cursor: str) -> ListPage:
    linked = not {"limit", "cursor"}.isdisjoint(request.query_params)
    if not cursor:
        return ListPage(limit, "", request.url, linked)
    try:
        text = base64.b64decode(cursor + "=" * (-len(cursor) % 4), b"-_", validate=True).decode()
    except ValueError:  # it is not ASCII, Base64 or UTF-8
        text = ""
    path, _, key = text.partition("\n")
    if path != request.url.path or not key:
        raise Problem(
            422,
            "cursor: it is none of this list.",
            "Follow the Link of the page before, or leave it out to begin with the first page.",
            key="cursor",
        )
    return ListPage(limit, key, request.url, linked)


async def _any(request: Request, limit: Limit = 0, cursor: Cursor = "") -> ListPage:
    return _page(request, limit, cursor)


async def _newest(request: Request, limit: Newest = 50, cursor: Cursor = "") -> ListPage:
    return _page(request, limit, cursor)


Paged = Annotated[ListPage, Depends(_any)]
NewestPage = Annotated[ListPage, Depends(_newest)]
