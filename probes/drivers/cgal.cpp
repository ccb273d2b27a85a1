// Runs CGAL's Efficient_RANSAC up to its first plane. Rows hold a point.
//
// It has neither a budget nor a count of trials. A shape type of our own, derived from CGAL's plane,
// sees every sample drawn; the callback of detect() ends a run that has used its budget, which then
// has the best plane drawn so far in hand.
#include "driver.hpp"

#include <random>

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Random.h>
#include <CGAL/Shape_detection/Efficient_RANSAC.h>
#include <CGAL/property_map.h>

namespace {

using driver::Answer;
using driver::Request;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;

struct Measured {
    Kernel::Point_3 point;
    Kernel::Vector_3 normal;
    int row;
};
using Range = std::vector<Measured>;

template <class Value, Value Measured::*Member>
struct Map {
    using key_type = Measured;
    using value_type = Value;
    using reference = const Value&;
    using category = boost::lvalue_property_map_tag;

    friend reference get(const Map&, const Measured& measured) { return measured.*Member; }
};
using Traits = CGAL::Shape_detection::Efficient_RANSAC_traits<
    Kernel, Range, Map<Kernel::Point_3, &Measured::point>, Map<Kernel::Vector_3, &Measured::normal>>;
using Efficient_ransac = CGAL::Shape_detection::Efficient_RANSAC<Traits>;

// What the shapes of one run share: CGAL makes them with no arguments.
struct State {
    const Range* range = nullptr;
    double epsilon = 0;
    long drawn = 0;
    std::vector<int> best;
};
State state;

class Plane : public CGAL::Shape_detection::Plane<Traits> {
    using Base = CGAL::Shape_detection::Plane<Traits>;

protected:
    void create_shape(const std::vector<std::size_t>& indices) override {
        ++state.drawn;
        if (indices.size() != 3) throw std::runtime_error("a sample is not of three points");
        Base::create_shape(indices);
        if (!this->m_is_valid) return;
        std::vector<int> inliers;
        for (const Measured& measured : *state.range)
            if (static_cast<const Base*>(this)->squared_distance(measured.point) <=
                state.epsilon * state.epsilon)
                inliers.push_back(measured.row);
        if (inliers.size() > state.best.size()) state.best = inliers;
    }
};

Answer detect(const Request& request) {
    CGAL::get_default_random() = CGAL::Random(request.seed);
    // Normals do not matter here: every direction passes.
    std::mt19937 generator(request.seed);
    std::uniform_real_distribution<double> uniform(0.1, 1.0);
    Range range;
    for (std::size_t i = 0; i < request.rows; ++i) {
        const double* from = request.row(i);
        range.push_back({{from[0], from[1], from[2]},
                         {uniform(generator), uniform(generator), uniform(generator)},
                         static_cast<int>(i)});
    }
    state = State{&range, request.threshold, 0, {}};

    Efficient_ransac ransac;
    ransac.set_input(range);
    ransac.add_shape_factory<Plane>();
    Efficient_ransac::Parameters parameters;
    parameters.epsilon = request.threshold;
    parameters.normal_threshold = 0.0;
    parameters.min_points = 10;
    // No plane is in pieces.
    parameters.cluster_epsilon = 1e3;
    parameters.probability = 1 - request.confidence;

    Answer answer;
    ransac.detect(parameters, [&](double extracted) {
        answer.trials = state.drawn;
        return extracted == 0 && state.drawn < request.max_trials;
    });
    const auto shapes = ransac.shapes();
    if (shapes.begin() != shapes.end()) {
        for (std::size_t index : (*shapes.begin())->indices_of_assigned_points())
            answer.inliers.push_back(range[index].row);
    } else {
        answer.inliers = state.best;
    }
    answer.found = !answer.inliers.empty();
    return answer;
}

}  // namespace

int main() { return driver::serve({{"planes", detect}}); }
