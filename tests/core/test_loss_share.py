"""The share of a scan's packets that are missing: of each scan by itself."""

from roller_core.scan_watch import LossShare, ScanReport


def scan(share: LossShare, packets: int, missing: int, start_ns: int) -> list[ScanReport]:
    """Reports of a scan of so many packets, of which the second follows a gap."""
    found = [share.see(start_ns + k, missing if k == 1 else 0) for k in range(packets)]
    return [report for report in [*found, share.end()] if report is not None]


def test_each_scan_has_a_share_of_its_own() -> None:
    share = LossShare()
    assert scan(share, 80, 20, 1000) == [
        ScanReport(1001, "20% of the event packets were lost: 20 of 100")
    ]
    assert scan(share, 100, 0, 2000) == []
    # It neither counts as reported nor is it thinned by the good one before it.
    assert scan(share, 90, 10, 3000) == [
        ScanReport(3001, "10% of the event packets were lost: 10 of 100")
    ]
