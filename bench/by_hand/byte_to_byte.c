/* A sensor's frame becomes an actuator's command, as one would write it by hand for one joint.
   byte_to_byte SENSOR ACTUATOR PERIOD_NS CYCLES PRIORITY SPIN_NS: the first two are descriptors, inherited. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { SIZE = 10, MARK = 0xA5 }; /* mark, double, sum of the double's bytes */

static unsigned char sum(const unsigned char *bytes)
{
    unsigned char total = 0;
    for (int i = 1; i < SIZE - 1; i++)
        total += bytes[i];
    return total;
}

static double within(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

static long long now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

int main(int argc, char **argv)
{
    if (argc != 7 || prctl(PR_SET_PDEATHSIG, SIGKILL))
        return 2;
    int sensor = atoi(argv[1]), actuator = atoi(argv[2]), cycles = atoi(argv[4]), held = 0, zero = 0;
    int awake = open("/dev/cpu_dma_latency", O_WRONLY);
    long long period = atoll(argv[3]), spin = atoll(argv[6]);
    struct sched_param priority = {.sched_priority = atoi(argv[5])};
    unsigned char in[4096], out[SIZE] = {MARK};
    double wanted = 0, sent = 0, dt = period / 1e9;
    mlockall(MCL_CURRENT | MCL_FUTURE);
    prctl(PR_SET_TIMERSLACK, 1);
    if (awake >= 0 && write(awake, &zero, sizeof zero) < 0)
        close(awake);
    sched_setscheduler(0, SCHED_FIFO, &priority);
    for (long long deadline = now() + period; cycles > 0; cycles--, deadline += period) {
        long long until = deadline - spin;
        struct timespec t = {until / 1000000000LL, until % 1000000000LL};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        while (now() < deadline)
            ;
        ssize_t came = recv(sensor, in + held, sizeof in - held, MSG_DONTWAIT);
        int at = 0;
        held += came > 0 ? came : 0;
        while (held - at >= SIZE) {
            double value;
            memcpy(&value, in + at + 1, sizeof value);
            int whole = in[at] == MARK && in[at + SIZE - 1] == sum(in + at);
            if (whole && isfinite(value))
                wanted = value;
            at += whole ? SIZE : 1;
        }
        memmove(in, in + at, held -= at);
        sent = within(within(wanted, -2, 2), sent - 10 * dt, sent + 10 * dt); /* rad, rad/s */
        memcpy(out + 1, &sent, sizeof sent);
        out[SIZE - 1] = sum(out);
        send(actuator, out, SIZE, MSG_DONTWAIT | MSG_NOSIGNAL);
    }
    return 0;
}
