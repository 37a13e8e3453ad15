"""Answers over HTTP: a file or a refusal, with the headers that keep a page to itself."""

from http import HTTPStatus

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from bunraku.nodes.web.files import Asset


def answer(status: HTTPStatus, file: Asset, request: Request, scheme: str) -> Response:
    """A file as the browser wants it: compressed where it can read that. ``scheme`` is http or https."""
    headers = Headers(security_headers(request.headers.get("Host", ""), scheme))
    body = file.body
    headers["Content-Type"] = file.type
    headers["Cache-Control"] = "no-cache"
    headers["Vary"] = "Accept-Encoding"
    if file.packed and "gzip" in request.headers.get("Accept-Encoding", ""):
        body = file.packed
        headers["Content-Encoding"] = "gzip"
    if file.etag:
        headers["ETag"] = file.etag
    if file.filename:
        headers["Content-Disposition"] = f'attachment; filename="{file.filename}"'
    headers["Content-Length"] = str(len(body))
    headers["Connection"] = "close"
    return Response(status.value, status.phrase, headers, body)


def refusal(status: HTTPStatus, text: str) -> Response:
    """A line that says why nothing is served."""
    body = text.encode()
    headers = Headers({"Content-Type": "text/plain", "Content-Length": str(len(body)), "Connection": "close"})
    return Response(status.value, status.phrase, headers, body)


def security_headers(host: str, scheme: str) -> dict[str, str]:
    """The headers of every answer: nothing is loaded from elsewhere, nothing frames the page."""
    socket = f"{'wss' if scheme == 'https' else 'ws'}://{host}"
    policy = (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        f"connect-src 'self' {socket}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return {
        "Content-Security-Policy": policy,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
    }
