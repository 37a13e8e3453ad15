"""The `hid` driver: a pen tablet's own reports, by hidapi, where no driver of the system decodes them."""

import importlib
import os
import sys
import threading
from typing import Any, ClassVar

from bunraku.nodes.input_pen.hid_descriptor import DescriptorError
from bunraku.nodes.input_pen.hid_report import DIGITIZER, WACOM_PAGE, Decoder, decoder_of
from bunraku.nodes.input_pen.tablet import TabletDriver
from bunraku.nodes.input_pen.wacom import START, WACOM
from bunraku.runtime.driver import DriverProblem

PATIENCE = 100
"""ms that the reading thread waits for a report before it looks whether it is to end."""


def library() -> Any:
    """hidapi: on Linux by hidraw, which leaves the system's own driver at work."""
    try:
        return importlib.import_module("hidraw" if sys.platform == "linux" else "hid")
    except ImportError as error:
        raise DriverProblem(f"hid: hidapi does not load ({error}); pip install hidapi") from None


def text_of(path: bytes | str) -> str:
    """A device's path for people."""
    return path.decode("utf-8", "replace") if isinstance(path, bytes) else path


class HidDriver(TabletDriver):
    """Reads one tablet; a thread waits for its reports and posts them into the node's loop."""

    name: ClassVar[str] = "hid"

    def open(self) -> None:
        self.hidapi = library()
        self.handle: Any = None
        self.decoder: Decoder | None = None
        self.reader: threading.Thread | None = None
        self.ending = threading.Event()
        super().open()

    def connect(self) -> str:
        wanted = str(self.host.option("hid"))
        denied, odd = "", ""
        for one in self.hidapi.enumerate():
            if not self._meant(one, wanted):
                continue
            path = text_of(one["path"])
            handle = self.hidapi.device()
            try:
                handle.open_path(one["path"])
            except OSError:
                denied = denied or path
                continue
            try:
                decoder = decoder_of(_descriptor(handle), one["vendor_id"], one["product_id"])
            except (OSError, DescriptorError) as error:
                odd, decoder = f"{path}: its report descriptor cannot be used ({error})", None
            if decoder is not None:
                self._begin(one, handle, decoder)
                return ""
            handle.close()
        if denied:
            vendor = 'KERNEL=="hidraw*", TAG+="uaccess"'
            exists = os.path.exists(denied) and not os.access(denied, os.R_OK | os.W_OK)
            reason = f"no permission for {denied}; add the udev rule {vendor} and plug the tablet in again"
            return reason if exists else f"{denied} cannot be opened; end the program that holds it"
        if odd:
            return odd
        if wanted:
            return f"no pen tablet is {wanted}; give parameter hid a path like /dev/hidraw3, or VENDOR:PRODUCT in hex"
        return "no pen tablet found; plug one in, give parameter hid its path, or use driver evdev or web"

    def disconnect(self) -> None:
        self.ending.set()
        if self.reader is not None and self.reader is not threading.current_thread():
            self.reader.join(10.0 * PATIENCE / 1000.0)
        self.handle.close()

    def take(self, handle: Any, report: bytes, at: int) -> None:
        """One report, in the node's loop."""
        if handle is not self.handle or not self.held or self.decoder is None:
            return
        stylus = self.decoder.report(report)
        if stylus is not None:
            self.stylus = stylus
            self.say(at)

    def gone(self, handle: Any, why: str) -> None:
        """The reading thread has ended by itself."""
        if handle is self.handle:
            self.lost(why)

    # Inside

    def _meant(self, one: dict[str, Any], wanted: str) -> bool:
        if wanted:
            number = f"{one['vendor_id']:04x}:{one['product_id']:04x}"
            return wanted == text_of(one["path"]) or wanted.lower() == number
        return one["usage_page"] in (DIGITIZER, WACOM_PAGE) or one["vendor_id"] == WACOM

    def _begin(self, one: dict[str, Any], handle: Any, decoder: Decoder) -> None:
        if one["vendor_id"] == WACOM:
            try:
                handle.send_feature_report(START)
            except (OSError, ValueError):
                self.host.log.info("%s: does not take the mode of whole reports", text_of(one["path"]))
        self.handle, self.decoder, self.ending = handle, decoder, threading.Event()
        name = os.path.basename(text_of(one["path"])) or f"{one['vendor_id']:04x}-{one['product_id']:04x}"
        note = " ".join(word for word in (one.get("manufacturer_string"), one.get("product_string")) if word)
        self.found(f"hid-{name}", decoder.size_m, decoder.fields, note or "pen tablet")
        self.reader = threading.Thread(target=self._read, args=(handle, self.ending), name="hid", daemon=True)
        self.reader.start()

    def _read(self, handle: Any, ending: threading.Event) -> None:
        why = ""
        while not ending.is_set():
            try:
                report = bytes(handle.read(4096, PATIENCE))
            except (OSError, ValueError) as error:
                why = str(error) or "read error"
                break
            if report:
                at = self.host.clock()
                self.host.post(lambda report=report, at=at: self.take(handle, report, at))
        if not ending.is_set():
            self.host.post(lambda: self.gone(handle, why))


def _descriptor(handle: Any) -> bytes:
    try:
        return bytes(handle.get_report_descriptor())
    except AttributeError:
        raise OSError("hidapi is older than 0.14") from None


__all__ = ["HidDriver", "library"]
