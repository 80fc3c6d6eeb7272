// The line to the server: messages in, wishes out; comes back by itself, and notices when nothing comes any more.

const SILENT_MS = 800; // the server says something four times a second

export function connect(hear, state) {
  const link = { socket: null };
  let heard = -Infinity;
  setInterval(() => {
    const silent = performance.now() - heard, open = link.socket.readyState === WebSocket.OPEN;
    document.body.classList.toggle("stale", silent > SILENT_MS);
    if (open && heard > 0 && silent > SILENT_MS) state("off", `no news for ${Math.max(1, Math.round(silent / 1000))} s`);
  }, 100);
  const address = new URL("ws", location.href);
  address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  address.search = location.search;
  let wait = 250;
  const open = () => {
    const socket = new WebSocket(address);
    link.socket = socket;
    socket.onopen = () => { wait = 250; };
    socket.onmessage = (event) => { heard = performance.now(); hear(JSON.parse(event.data)); };
    socket.onclose = () => {
      heard = -Infinity;
      state("off", "not connected");
      setTimeout(open, wait);
      wait = Math.min(2 * wait, 4000);
    };
  };
  // Returns whether there is a connection to send it by.
  link.send = (message) => {
    const there = link.socket.readyState === WebSocket.OPEN;
    if (there) link.socket.send(JSON.stringify(message));
    return there;
  };
  open();
  return link;
}
