// What comes from the server: frames of the state, and what they say has changed.

const frame = (buffer) => {
  const size = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  return { header, buffer, offset: 4 + size };
};

async function binary(address) {
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(`${address}: ${answer.status}`);
  return frame(await answer.arrayBuffer());
}

/** Runs one request at a time; asked again meanwhile, it runs once more. */
function single(work) {
  let busy = false, again = false;
  return async () => {
    again = true;
    if (busy) return;
    busy = true;
    try {
      while (again) {
        again = false;
        await work();
      }
    } catch { /* the next frame asks again */ } finally { busy = false; }
  };
}

/** Follow the scene; `on` has callbacks state, tiles, depth, text, findings, files, offline. */
export function follow(tiles, on) {
  let latest = null;
  const had = { depth: 0, depthAt: -1e9, text: 0, findings: -1, files: false };
  const map = single(async () => {
    let more = true;
    while (more) {
      const found = await binary(`/api/map?epoch=${tiles.epoch}&since=${tiles.revision}`);
      tiles.take(found);
      more = found.header.more;
      on.tiles();
    }
  });
  const depth = single(async () => {
    const found = await binary("/api/depth");
    had.depth = found.header.revision;
    had.depthAt = performance.now();
    on.depth(found);
  });
  const text = single(async () => {
    const revision = latest.text_revision;
    on.text(await (await fetch("/api/text")).text());
    had.text = revision;
  });
  const findings = single(async () => {
    const revision = latest.findings_revision;
    on.findings(await (await fetch("/api/findings")).json());
    had.findings = revision;
  });
  const files = single(async () => {
    had.files = true;
    on.files(await (await fetch("/api/files")).json());
  });
  const source = new EventSource("/api/events");
  source.onmessage = ({ data }) => {
    latest = JSON.parse(data);
    on.state(latest);
    if (latest.map.epoch !== tiles.epoch || latest.map.revision > tiles.revision) map();
    // A picture for people: two a second are enough.
    if (latest.depth_revision !== had.depth && performance.now() - had.depthAt > 450) depth();
    if (latest.text_revision !== had.text) text();
    if (latest.findings_revision !== had.findings) findings();
    if (!latest.live && !had.files) files();
  };
  source.onerror = () => {
    // A new server counts from the start again.
    had.depth = had.text = had.findings = -1;
    on.offline();
  };
}
