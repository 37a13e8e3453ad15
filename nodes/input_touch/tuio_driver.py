"""The `tuio` driver: a plain UDP socket in front of the decoder."""

import ipaddress
import select
import socket

from bunraku.nodes.input_touch.frame import Frame
from bunraku.nodes.input_touch.tuio import BadDatagram, TuioDecoder
from bunraku.runtime.driver import Driver, DriverProblem

SECOND = 1_000_000_000
BURST = 512
"""Datagrams read at a time, so that a flood does not keep the node from its other work."""
BUFFER = 1 << 20


class TuioDriver(Driver):
    """Hears TUIO 1.1 on `host`:`port`."""

    name = "tuio"

    def open(self) -> None:
        host, port = str(self.host.option("host")), int(self.host.option("port"))
        size = list(self.host.option("size_m"))
        if size and (len(size) != 2 or min(size) <= 0.0):
            raise DriverProblem(f"size_m: {size} is no width and height in m; give two positive numbers or none")
        self.decoder = TuioDecoder((size[0], size[1]) if size else None)
        try:
            family = socket.AF_INET6 if ipaddress.ip_address(host).version == 6 else socket.AF_INET
        except ValueError:
            raise DriverProblem(f"host: {host!r} is no IP address; give 127.0.0.1, or 0.0.0.0 for all") from None
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        try:
            self.socket.bind((host, port))
        except OSError as error:
            self.socket.close()
            raise DriverProblem(
                f"tuio: cannot hear {host}:{port} ({error.strerror}); give another with parameter port"
            ) from None
        self.port = int(self.socket.getsockname()[1])
        self.told_late = 0
        self.host.add_reader(self.socket.fileno(), self.read)
        self.host.log.info("hears TUIO on %s:%d", host, self.port)

    def close(self) -> None:
        self.host.remove_reader(self.socket.fileno())
        self.socket.close()

    def keep(self, now: int) -> None:
        gone = self.decoder.silent(now - round(float(self.host.option("lost")) * SECOND))
        for device in gone:
            self.host.gone(device, "the sender fell silent")
        if self.decoder.late != self.told_late and now % SECOND < SECOND // 10:
            self.host.log.info("%d datagrams came too late and were left out", self.decoder.late - self.told_late)
            self.told_late = self.decoder.late

    def read(self) -> None:
        """Take what has come; wait a moment for the rest of a frame that comes in parts."""
        self._drain()
        linger = float(self.host.option("merge"))
        end = self.host.clock() + round(linger * SECOND)
        while self.decoder.waiting() and self.host.clock() < end:
            # A frame's datagrams follow each other within microseconds; this node has nothing else to do meanwhile.
            if not select.select([self.socket], [], [], linger)[0]:
                break
            self._drain()
        for frame in self.decoder.flush(self.host.clock()):
            self._say(frame)

    def _drain(self) -> None:
        for _ in range(BURST):
            try:
                body, address = self.socket.recvfrom(65535)
            except BlockingIOError:
                return
            except OSError as error:
                self.host.garbage(f"{error.strerror}")
                return
            try:
                frames = self.decoder.datagram(body, f"{address[0]}:{address[1]}", self.host.clock())
            except BadDatagram as error:
                self.host.garbage(f"datagram of {len(body)} bytes from {address[0]}: {error}")
                continue
            for frame in frames:
                self._say(frame)

    def _say(self, frame: Frame) -> None:
        size = self.decoder.size_m
        fields = ["major", "minor", "angle"] if size else []
        if self.host.connected(frame.device, driver="tuio", size_m=size, fields=fields):
            self.host.frame(frame)
