"""The program that runs on the controller: it follows the registers, and stops the arm if no more commands come.

One pass of its loop is one control cycle: `speedj`, `servoj` and `sync` each end with the cycle. All registers
of one data message change together between two cycles. If a command's number changes while the script reads it, the
script takes the command in the next pass.

These end the program: no successor within the time for which a command is valid (the arm ramps down first), the
END command, commands that carry another driver's number, a minute without any command. While the arm follows, RTDE's
own watchdog backs up the program's: it stops the program if this loop itself hangs.
"""

from __future__ import annotations

from typing import Final

from srl.drivers.ur.config import UrConfig
from srl.drivers.ur.registers import CYCLE, MODE, NONCE, SEQUENCE, STATE, TIMEOUT, VALUES, Mode, ScriptState

NAME: Final = "srl_control"
WATCHDOG: Final = 4.0  # Hz, lowest rate of inputs while the arm follows
STRANGE: Final = 250  # cycles for which commands of another driver are tolerated: our own first command may come late
ALONE: Final = 30_000  # cycles at rest without a new command

_TEXT: Final = """\
def {name}():
  nonce = {nonce}
  taken = read_input_integer_register({sequence})
  mode = {{stay}}
  cycles = 0
  goal = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
  silent = 0
  strange = 0
  state = {{ready}}
{setup}  write_output_integer_register({sequence}, taken)
  write_output_integer_register({state}, state)
  write_output_integer_register({nonce_at}, nonce)
  while state <= {{following}}:
    number = read_input_integer_register({sequence})
    asked = read_input_integer_register({mode})
    held = read_input_integer_register({timeout})
    values = [{values}]
    if read_input_integer_register({nonce_at}) != nonce:
      mode = {{stay}}
      strange = strange + 1
    elif number != taken and number == read_input_integer_register({sequence}):
      taken = number
      mode = asked
      cycles = held
      goal = values
      silent = 0
      strange = 0
      write_output_integer_register({sequence}, taken)
    else:
      silent = silent + 1
    end
    if mode == {{end}}:
      state = {{ended}}
    elif strange > {strange} or silent > {alone}:
      state = {{abandoned}}
    elif mode == {{follow}} and silent >= cycles:
      state = {{timed_out}}
    elif mode == {{follow}}:
      if state == {{ready}}:
        state = {{following}}
        write_output_integer_register({state}, state)
        rtde_set_watchdog("input_int_register_{sequence}", {watchdog}, "stop")
      end
      {motion}
    elif state == {{following}}:
      stopj({deceleration})
      state = {{ready}}
      write_output_integer_register({state}, state)
      rtde_set_watchdog("input_int_register_{sequence}", {watchdog}, "ignore")
    else:
      sync()
    end
  end
  write_output_integer_register({state}, state)
  stopj({deceleration})
end
"""


def program(config: UrConfig, nonce: int) -> str:
    """Returns the program's text for one upload.

    Args:
        config: the arm's options.
        nonce: number of this upload, 1 to 2**31 - 1; commands with another number are not obeyed.
    """
    motion = (
        f"speedj(goal, {config.acceleration}, {CYCLE})"
        if config.interface == "velocity"
        else f"servoj(goal, 0, 0, {CYCLE}, {config.lookahead}, {config.gain})"
    )
    setup = ""
    if config.payload is not None:
        x, y, z = config.payload_cog
        # Setting the payload zeroes the force sensor, even while something is touched. So it is set only if it differs.
        setup = f"""\
  told = get_target_payload_cog()
  cog = [{x:.6f}, {y:.6f}, {z:.6f}]
  other = norm(told[0] - cog[0]) + norm(told[1] - cog[1]) + norm(told[2] - cog[2]) > 0.0001
  if other or norm(get_target_payload() - {config.payload:.6f}) > 0.001:
    set_payload({config.payload:.6f}, cog)
  end
"""
    if config.tcp is not None:
        wanted = ", ".join(f"{value:.6f}" for value in config.tcp)
        differ = " + ".join(f"norm(tcp[{i}] - wanted[{i}])" for i in range(6))
        setup += f"""\
  tcp = get_tcp_offset()
  wanted = p[{wanted}]
  if {differ} > 0.0001:
    set_tcp(wanted)
  end
"""
    numbered = _TEXT.format(
        name=NAME, nonce=nonce, sequence=SEQUENCE, state=STATE, nonce_at=NONCE, mode=MODE, timeout=TIMEOUT,
        values=", ".join(f"read_input_float_register({VALUES + joint})" for joint in range(6)),
        strange=STRANGE, alone=ALONE, watchdog=WATCHDOG, motion=motion, deceleration=config.deceleration,
        setup=setup,
    )  # fmt: skip
    words = {mode.name.lower(): int(mode) for mode in Mode}
    return numbered.format(**words, **{state.name.lower(): int(state) for state in ScriptState})
