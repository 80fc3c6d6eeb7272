// The line to the server: messages in, wishes out; comes back by itself.

export function connect(hear, state) {
  const link = { socket: null };
  const address = new URL("ws", location.href);
  address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  address.search = location.search;
  let wait = 250;
  const open = () => {
    const socket = new WebSocket(address);
    link.socket = socket;
    socket.onopen = () => { wait = 250; };
    socket.onmessage = (event) => hear(JSON.parse(event.data));
    socket.onclose = () => {
      state("off", "not connected");
      setTimeout(open, wait);
      wait = Math.min(2 * wait, 4000);
    };
  };
  link.send = (message) => {
    if (link.socket.readyState === WebSocket.OPEN) link.socket.send(JSON.stringify(message));
  };
  open();
  return link;
}
