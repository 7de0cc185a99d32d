// A ball in C++17, a force that is a lambda, an error that is an exception.
//
//     c++ -std=c++17 ball.cpp -I<prefix>/include -L<prefix>/lib -lzivi
#include <cmath>
#include <cstdio>

#include "zivi.hpp"

int main()
{
    zivi::System ball;
    ball.force = -9.81;
    ball.e = 0.5;
    const zivi::Run run = zivi::simulate(ball, 0.0, 4.0, 1.0, 0.0);
    const double fall = std::sqrt(2.0 / 9.81);
    std::printf("at rest from %.12f s on, exactly %.12f\n", run.rest_time(), 3.0 * fall);

    zivi::System table = ball; // seen from a table that vibrates
    table.function = [](double t, double, double) { return -9.81 + 14.0 * std::sin(12.0 * t); };
    zivi::Method method;
    method.rtol = 1e-9;
    std::printf("%zu impacts on the table\n", zivi::simulate(table, 0.0, 2.0, 0.2, 0.0, method).impacts().size());

    const zivi::Solution root = zivi::solve_vi(
        [](const std::vector<double> &z, std::vector<double> &f) { f[0] = z[0] * z[0] * z[0] - 2.0; },
        {1.0});
    std::printf("2^(1/3) = %.12f\n", root.z[0]);

    bool thrown = false;
    try {
        ball.e = 1.5;
        zivi::simulate(ball, 0.0, 4.0, 1.0, 0.0);
    } catch (const zivi::Error &error) {
        thrown = true;
        std::printf("refused: %s\n", error.what());
    }
    const bool right = std::abs(run.rest_time() - 3.0 * fall) < 1e-9 && root.solved() && thrown;
    return right ? 0 : 1;
}
