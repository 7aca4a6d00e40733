// A page's connection to its server, and the clocks of both: all times are the server's, in ms.

const PING = 500, AGAIN = 500; // ms between pings, and between attempts to connect
const PINGS = 40; // round trips that are remembered
const ANSWER = 3000; // ms that a stop may take to be confirmed
const FIRST = 250, TRIES = [0, 400, 1000]; // ms that the open connection has alone, and when new ones are tried after it
const REFUSED = "The stop wasn't confirmed. Use the hardware stop", UNSENT = "The stop can't be sent. Use the hardware stop";

// The secret that lets this page speak. The page that the printed address gives holds it, once; the browser keeps it for
// this origin alone, port included, and for all tabs of it.
const KEY = (() => {
  const given = document.querySelector("meta[name=key]");
  if (!given) return localStorage.getItem("key") || "";
  localStorage.setItem("key", given.content);
  given.remove();
  history.replaceState(null, "", "/"); // to be loaded again without the token, which is spent
  return localStorage.getItem("key");
})();

export class Link {
  // deliver(message): what the server says. lost(): the connection has ended; another attempt follows.
  constructor(deliver, lost) {
    [this.deliver, this.lost] = [deliver, lost];
    this.socket = null;
    this.heard = 0; // when the newest message came, on the page's own clock
    this.trips = []; // {trip, offset} of the newest pings
    this.stops = new Map(); // by number, what to call with the answer to a stop; null: the connection has ended
    this.connect();
    setInterval(() => this.ping(), PING);
  }

  connect() {
    const made = new WebSocket(`ws://${location.host}/socket`, ["srl", ...(KEY ? [KEY] : [])]);
    made.onopen = () => { this.socket = made; this.trips = []; this.ping(); };
    made.onmessage = ({ data }) => this.hear(JSON.parse(data));
    made.onclose = () => {
      this.socket = null;
      for (const settle of this.stops.values()) settle(null);
      this.lost();
      setTimeout(() => this.connect(), AGAIN);
    };
  }

  say(message) {
    if (this.socket && this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  // Resolves once the loop has confirmed a stop over the open connection.
  stop(signal) {
    const at = performance.now();
    return new Promise((resolve, reject) => {
      this.stops.set(at, (ok) => (ok ? resolve() : reject(ok === null ? UNSENT : REFUSED)));
      signal.addEventListener("abort", () => reject(UNSENT));
      this.say({ kind: "stop", at });
    }).finally(() => this.stops.delete(at));
  }

  ping() { this.say({ kind: "ping", at: performance.now() }); }

  hear(message) {
    this.heard = performance.now();
    if (message.kind === "stopped") { this.stops.get(message.at)?.(message.ok); return; }
    if (message.kind !== "pong") { this.deliver(message); return; }
    const trip = this.heard - message.at;
    this.trips = [...this.trips.slice(1 - PINGS), { trip, offset: message.now - message.at - trip / 2 }];
  }

  // The least round trip knows the server's clock best.
  best() { return this.trips.reduce((a, b) => (b.trip < a.trip ? b : a), { trip: Infinity, offset: NaN }); }

  time(at) { return at + this.best().offset; }
}

// Asks for a stop: over the page's open connection at once, over new ones while none has confirmed it. Others may hold
// every new one. Returns what is wrong with it; empty if the loop has confirmed it.
export async function stop(link) {
  const over = new AbortController(), open = link && link.socket;
  const ways = TRIES.map((wait) => post(open ? wait + FIRST : wait, over.signal));
  if (open) ways.push(link.stop(over.signal));
  setTimeout(() => over.abort(), ANSWER);
  try { await Promise.any(ways); return ""; }
  catch ({ errors }) { return errors.includes(REFUSED) ? REFUSED : UNSENT; }
  finally { over.abort(); }
}

async function post(wait, signal) {
  await new Promise((done) => setTimeout(done, wait));
  if (signal.aborted) throw UNSENT;
  const answer = await fetch("/stop", { method: "POST", headers: { "X-Srl-Key": KEY }, keepalive: true, signal });
  if (!(await answer.json()).ok) throw REFUSED; // the rows tell that it stands
}
