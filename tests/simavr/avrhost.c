// Minimal ATmega328P board host on libsimavr (Debian libsimavr-dev): UART0 <-> pty, GPIO/ADC over stdin/stdout.
// libsimavr is GPL-3, so the compiled program is too: it is built by the test that needs it and stays out of the wheel.
//
// avrhost FIRMWARE.hex [LINK [SPEED]]: prints "pty PATH", then answers one line for each on stdin:
//   in PIN 0|1|2   short to ground, drive high, release      out PIN    direction, level, last pulse (us), pulses,
//                                                                        shortest and longest since last asked
//   adc CHANNEL mV                                           time       simulated seconds, bytes dropped
//   reset          as the reset button                       quit
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_hex.h>
#include <simavr/avr_uart.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_adc.h>

static avr_t *avr;
static int master = -1;
static int xon = 1;
static avr_irq_t *uart_in;
static uint64_t rise[3][8];
static uint32_t width[3][8];   // last high time, cycles
static uint32_t npulse[3][8];
static uint32_t shortest[3][8], longest[3][8];   // since the last `out`, cycles; 0: no pulse
static uint8_t level[3][8];
static const char PORTS[3] = {'B', 'C', 'D'};
static unsigned long dropped;

static void on_tx(avr_irq_t *irq, uint32_t v, void *p) {
    unsigned char b = v;
    if (write(master, &b, 1) != 1) dropped++;
}
static void on_xon(avr_irq_t *irq, uint32_t v, void *p) { xon = 1; }
static void on_xoff(avr_irq_t *irq, uint32_t v, void *p) { xon = 0; }
static void on_pin(avr_irq_t *irq, uint32_t v, void *p) {
    long id = (long)p; int port = id >> 3, bit = id & 7;
    uint8_t nv = v & 1;
    if (nv == level[port][bit]) return;
    level[port][bit] = nv;
    if (nv) rise[port][bit] = avr->cycle;
    else { width[port][bit] = avr->cycle - rise[port][bit]; npulse[port][bit]++;
        uint32_t w = width[port][bit];
        if (!shortest[port][bit] || w < shortest[port][bit]) shortest[port][bit] = w;
        if (w > longest[port][bit]) longest[port][bit] = w; }
}
static int where(int pin, int *port, int *bit) {  // Arduino Uno/Nano digital number -> AVR port bit
    if (pin >= 0 && pin <= 7) { *port = 2; *bit = pin; }
    else if (pin <= 13) { *port = 0; *bit = pin - 8; }
    else if (pin <= 19) { *port = 1; *bit = pin - 14; }
    else return -1;
    return 0;
}
static void command(char *line) {
    int a, b, port, bit;
    if (sscanf(line, "in %d %d", &a, &b) == 2 && !where(a, &port, &bit)) {
        static uint8_t mask[3], val[3];
        // b: 0 = pulled to GND, 1 = driven high, 2 = released (internal pull-up decides)
        mask[port] = b == 2 ? mask[port] & ~(1u << bit) : mask[port] | (1u << bit);
        val[port] = b == 1 ? val[port] | (1u << bit) : val[port] & ~(1u << bit);
        avr_ioport_external_t e = {.name = PORTS[port], .mask = mask[port], .value = val[port]};
        avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(PORTS[port]), &e);
        avr_ioport_state_t s; avr_ioctl(avr, AVR_IOCTL_IOPORT_GETSTATE(PORTS[port]), &s);
        if (!((s.ddr >> bit) & 1))
            avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(PORTS[port]), bit), b == 2 ? (s.port >> bit) & 1 : b);
        printf("ok in %d %d\n", a, b);
    } else if (sscanf(line, "adc %d %d", &a, &b) == 2) {
        avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + a), b);
        printf("ok adc %d %d\n", a, b);
    } else if (sscanf(line, "out %d", &a) == 1 && !where(a, &port, &bit)) {
        avr_ioport_state_t s; avr_ioctl(avr, AVR_IOCTL_IOPORT_GETSTATE(PORTS[port]), &s);
        printf("out %d ddr=%d port=%d pin=%d level=%d us=%.3f n=%u min=%.3f max=%.3f\n", a, (s.ddr >> bit) & 1, (s.port >> bit) & 1,
               (s.pin >> bit) & 1, level[port][bit], width[port][bit] / 16.0, npulse[port][bit],
               shortest[port][bit] / 16.0, longest[port][bit] / 16.0);
        shortest[port][bit] = longest[port][bit] = 0;
    } else if (!strncmp(line, "reset", 5)) {
        avr_reset(avr); xon = 1;
        printf("ok reset\n");
    } else if (!strncmp(line, "time", 4)) {
        printf("time %.6f dropped=%lu\n", avr->cycle / 16e6, dropped);
    } else if (!strncmp(line, "quit", 4)) exit(0);
    else printf("err %s\n", line);
    fflush(stdout);
}
int main(int argc, char **argv) {
    const char *fw = argv[1], *link = argc > 2 ? argv[2] : NULL;
    double speed = argc > 3 ? atof(argv[3]) : 1.0;
    avr = avr_make_mcu_by_name("atmega328p");
    if (!avr) return 1;
    avr_init(avr);
    avr->frequency = 16000000; avr->vcc = avr->avcc = avr->aref = 5000; avr->log = 1;
    if (strstr(fw, ".hex")) {
        ihex_chunk_p ch = NULL; int n = read_ihex_chunks(fw, &ch);
        for (int i = 0; i < n; i++) if (ch[i].baseaddr < avr->flashend) {
            memcpy(avr->flash + ch[i].baseaddr, ch[i].data, ch[i].size);
            avr->codeend = ch[i].baseaddr + ch[i].size - 1;
        }
        avr->codeend = avr->flashend;
        avr->pc = 0;
    } else {
        elf_firmware_t f; memset(&f, 0, sizeof f);
        if (elf_read_firmware(fw, &f)) return 2;
        f.frequency = 16000000; avr_load_firmware(avr, &f);
    }
    int slave; char name[128]; struct termios t;
    if (openpty(&master, &slave, name, NULL, NULL)) return 3;
    tcgetattr(slave, &t); cfmakeraw(&t); tcsetattr(slave, TCSANOW, &t);
    fcntl(master, F_SETFL, O_NONBLOCK); fcntl(0, F_SETFL, O_NONBLOCK);
    if (link) { unlink(link); if (symlink(name, link)) perror("symlink"); }
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    uart_in = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_tx, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_xon, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_xoff, NULL);
    for (long p = 0; p < 3; p++) for (long b = 0; b < 8; b++) {
        avr_irq_t *i = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(PORTS[p]), b);
        if (i) avr_irq_register_notify(i, on_pin, (void *)(p << 3 | b));
    }
    printf("pty %s\n", name); fflush(stdout);
    struct timespec t0, now; clock_gettime(CLOCK_MONOTONIC, &t0);
    uint64_t slice = 16000;   // 1 ms of AVR time
    uint64_t next = slice, nextio = 0; char line[256]; size_t ll = 0;
    unsigned char buf[64]; int bl = 0, bi = 0;
    for (;;) {
        while (avr->cycle < next) { int s = avr_run(avr); if (s == cpu_Done || s == cpu_Crashed) { printf("cpu %d\n", s); return 4; }
            if (avr->cycle >= nextio) { nextio = avr->cycle + 800; while (xon) {
                if (bi == bl) { bl = read(master, buf, sizeof buf); bi = 0; if (bl <= 0) { bl = 0; break; } }
                avr_raise_irq(uart_in, buf[bi++]);
            } } }
        next += slice;
        char c; while (read(0, &c, 1) == 1) { if (c == '\n') { line[ll] = 0; command(line); ll = 0; } else if (ll < 255) line[ll++] = c; }
        clock_gettime(CLOCK_MONOTONIC, &now);
        double wall = (now.tv_sec - t0.tv_sec) + (now.tv_nsec - t0.tv_nsec) * 1e-9, sim = avr->cycle / 16e6 / speed;
        if (sim > wall) { double d = sim - wall; struct timespec ts = {(time_t)d, (long)((d - (time_t)d) * 1e9)}; nanosleep(&ts, NULL); }
    }
}
