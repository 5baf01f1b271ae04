// The moving picture of README, drawn by the page's own code within the page: the same cell under ALOHA and under the actor from
// its first slot on. Its value is the file's bytes, an animated WebP; the browser encodes the frames.
(async () => {
  const { Cell, load } = await import("./cell.js"), { drawMap } = await import("./map.js"), { mean } = await import("./charts.js");
  const { write } = await import("./canvas.js"), { colour, policyColour } = await import("./colours.js");
  // Chosen: 7 s that begin again, a slot shown for 60 ms; lossy enough for a page, sharp enough for digits.
  const WIDTH = 270, HEIGHT = 456, GAP = 22, HEAD = 44, FOOT = 30, SLOTS = 90, SLOTS_A_FRAME = 2, FRAME_MS = 120, LAST_MS = 2000, QUALITY = 0.6;
  const SHOWN_SLOTS = 20;
  // Bytes of the container's parts.
  const FILE_HEAD = 12, NAME = 4, CHUNK_HEAD = 8;

  const module = await load("freshlane.wasm");
  const sides = ["aloha", "actor"].map((policy) => {
    const map = document.createElement("canvas");
    Object.assign(map.style, { position: "fixed", left: 0, top: 0, width: `${WIDTH}px`, height: `${HEIGHT}px`, maxHeight: "none" });
    document.body.append(map);
    return { policy, map, cell: new Cell(module, { seed: "1", settings: [], policy, comparisons: [] }) };
  });
  const picture = Object.assign(document.createElement("canvas"), { width: 2 * WIDTH + 3 * GAP, height: HEAD + HEIGHT + FOOT });
  const context = picture.getContext("2d");

  const draw = (slots) => {
    context.fillStyle = colour("panel");
    context.fillRect(0, 0, picture.width, picture.height);
    sides.forEach(({ policy, map, cell }, side) => {
      const left = GAP + side * (WIDTH + GAP), [{ history }] = cell.histories(), from = Math.max(0, cell.elapsed - SHOWN_SLOTS);
      drawMap(map, cell, cell.vehicles(), null, slots);
      context.drawImage(map, left, HEAD, WIDTH, HEIGHT);
      const words = policy === "aloha" ? "ALOHA: by chance" : "Freshlane’s actor";
      write(context, words, left + 4, HEAD / 2, { size: 15, weight: 600, colour: colour(policyColour(policy)) });
      write(context, `${mean(history, from, cell.elapsed).toFixed(1)} ms`, left + WIDTH, HEAD / 2, { size: 20, weight: 600, align: "right", colour: colour("ink") });
    });
    const words = `mean age of what the base station knows of 20 vehicles; three channels, millisecond ${sides[0].cell.elapsed}`;
    write(context, words, picture.width / 2, HEAD + HEIGHT + FOOT / 2 - 2, { size: 13, align: "center", colour: colour("quiet") });
  };
  const encoded = async () => {
    const blob = await new Promise((done) => picture.toBlob(done, "image/webp", QUALITY)), bytes = new Uint8Array(await blob.arrayBuffer());
    // The browser puts a head and a colour profile before the picture itself.
    const of = (at) => new TextDecoder().decode(bytes.subarray(at, at + NAME)), length = (at) => new DataView(bytes.buffer).getUint32(at + NAME, true);
    let at = FILE_HEAD;
    while (!["VP8 ", "VP8L"].includes(of(at))) at += CHUNK_HEAD + length(at) + length(at) % 2;
    return bytes.subarray(at);
  };

  // The container: https://developers.google.com/speed/webp/docs/riff_container
  const little = (number, bytes) => Array.from({ length: bytes }, (_, i) => Math.floor(number / 256 ** i) % 256);
  const join = (...parts) => parts.flatMap((part) => [...part]);
  const chunk = (name, bytes) => join(new TextEncoder().encode(name), little(bytes.length, 4), bytes, bytes.length % 2 ? [0] : []);
  const size = join(little(picture.width - 1, 3), little(picture.height - 1, 3));
  const ANIMATED = 2, NO_BLENDING = 2;
  const frames = [];
  for (let slot = 0; slot < SLOTS; slot += SLOTS_A_FRAME) {
    for (const { cell } of sides) cell.advance(SLOTS_A_FRAME);
    draw(SLOTS_A_FRAME);
    const image = await encoded(), shown_ms = slot + SLOTS_A_FRAME < SLOTS ? FRAME_MS : LAST_MS;
    frames.push(chunk("ANMF", join(little(0, 6), size, little(shown_ms, 3), [NO_BLENDING], image)));
  }
  for (const { map } of sides) map.remove();
  const head = chunk("VP8X", join([ANIMATED, 0, 0, 0], size)), endless = chunk("ANIM", little(0, 6));
  return chunk("RIFF", join(new TextEncoder().encode("WEBP"), head, endless, ...frames));
})()
