// The page's program: one instance for each world. Text goes in and out through one buffer of its memory, numbers are read where they lie
// (web/src/exports.rs).

const text = { encoder: new TextEncoder(), decoder: new TextDecoder() };

/** What the program refuses, in its own words. */
export class Refusal extends Error {}

/** Loads the program once; every world is a new instance of it. */
export async function load(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: the server answers ${response.status}`);
  // Plain file servers may not know the media type that streaming compilation asks for.
  return WebAssembly.compile(await response.arrayBuffer());
}

export class Program {
  /** What JavaScript can call. */
  exports;

  constructor(module) { this.exports = new WebAssembly.Instance(module).exports; }

  /** Calls what takes a text and answers with one. Throws a Refusal. */
  ask(call, words) {
    const bytes = text.encoder.encode(words);
    this.view(Uint8Array, this.exports.cell_text(bytes.length), bytes.length).set(bytes);
    const good = call();
    const answer = this.view(Uint8Array, this.exports.cell_answer(), this.exports.cell_answer_length());
    const words_back = text.decoder.decode(answer);
    if (!good) throw new Refusal(words_back);
    return words_back;
  }

  /** Numbers at an address. Memory may have moved with every call: a view is good until the next one. */
  view(Type, address, length) { return new Type(this.exports.memory.buffer, address >>> 0, length); }
}
