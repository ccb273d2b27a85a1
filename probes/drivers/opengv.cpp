// Runs OpenGV's RANSAC on measurements of two viewpoints, of points in space, or of both.
//
// Rows: a bearing vector and a point (absolute pose), two bearing vectors (relative pose), or two
// points (point cloud). Inliers are the library's own.
#include "driver.hpp"

#include <algorithm>
#include <functional>
#include <memory>
#include <random>

#include <opengv/absolute_pose/CentralAbsoluteAdapter.hpp>
#include <opengv/point_cloud/PointCloudAdapter.hpp>
#include <opengv/relative_pose/CentralRelativeAdapter.hpp>
#include <opengv/sac/Ransac.hpp>
#include <opengv/sac_problems/absolute_pose/AbsolutePoseSacProblem.hpp>
#include <opengv/sac_problems/point_cloud/PointCloudSacProblem.hpp>
#include <opengv/sac_problems/relative_pose/CentralRelativePoseSacProblem.hpp>
#include <opengv/sac_problems/relative_pose/RotationOnlySacProblem.hpp>
#include <opengv/sac_problems/relative_pose/TranslationOnlySacProblem.hpp>

namespace {

using driver::Answer;
using driver::Request;
using Vectors = opengv::points_t;  // the same type as bearingVectors_t
using opengv::sac_problems::absolute_pose::AbsolutePoseSacProblem;
using opengv::sac_problems::point_cloud::PointCloudSacProblem;
using opengv::sac_problems::relative_pose::CentralRelativePoseSacProblem;
using opengv::sac_problems::relative_pose::RotationOnlySacProblem;
using opengv::sac_problems::relative_pose::TranslationOnlySacProblem;

Vectors side(const Request& request, int which) {
    Vectors vectors;
    for (std::size_t i = 0; i < request.rows; ++i) {
        const double* from = request.row(i) + 3 * which;
        vectors.emplace_back(from[0], from[1], from[2]);
    }
    return vectors;
}

template <class Problem>
Answer solve(const std::shared_ptr<Problem>& problem, const Request& request) {
    // Its own choice of seed is a constant or the time.
    problem->rng_gen_ = std::make_shared<std::function<int()>>(
        std::bind(*problem->rng_dist_, std::mt19937(request.seed)));
    opengv::sac::Ransac<Problem> ransac;
    ransac.sac_model_ = problem;
    ransac.threshold_ = request.threshold;
    if (!request.at_defaults()) {
        // A budget of T runs T + 1 trials, and one of 0 none: one trial is that of confidence 0.
        ransac.max_iterations_ = static_cast<int>(std::max(1L, request.max_trials - 1));
        ransac.probability_ = request.max_trials == 1 ? 0.0 : request.confidence;
    }
    Answer answer;
    answer.found = ransac.computeModel();
    answer.trials = ransac.iterations_;
    answer.inliers = ransac.inliers_;
    return answer;
}

driver::Run absolute_pose(AbsolutePoseSacProblem::algorithm_t algorithm) {
    return [algorithm](const Request& request) {
        const Vectors bearings = side(request, 0), points = side(request, 1);
        // The rotation is known to the two-point solver: the identity.
        const opengv::rotation_t rotation = opengv::rotation_t::Identity();
        opengv::absolute_pose::CentralAbsoluteAdapter adapter(bearings, points, rotation);
        return solve(std::make_shared<AbsolutePoseSacProblem>(adapter, algorithm), request);
    };
}

template <class Problem, class... Choice>
driver::Run relative_pose(Choice... choice) {
    return [choice...](const Request& request) {
        const Vectors first = side(request, 0), second = side(request, 1);
        const opengv::rotation_t rotation = opengv::rotation_t::Identity();
        opengv::relative_pose::CentralRelativeAdapter adapter(first, second, rotation);
        return solve(std::make_shared<Problem>(adapter, choice...), request);
    };
}

Answer point_cloud(const Request& request) {
    const Vectors first = side(request, 0), second = side(request, 1);
    opengv::point_cloud::PointCloudAdapter adapter(first, second);
    return solve(std::make_shared<PointCloudSacProblem>(adapter), request);
}

}  // namespace

int main() {
    using Central = CentralRelativePoseSacProblem;
    return driver::serve({
        {"absolute_pose.twopt", absolute_pose(AbsolutePoseSacProblem::TWOPT)},
        {"absolute_pose.kneip", absolute_pose(AbsolutePoseSacProblem::KNEIP)},
        {"absolute_pose.gao", absolute_pose(AbsolutePoseSacProblem::GAO)},
        {"absolute_pose.epnp", absolute_pose(AbsolutePoseSacProblem::EPNP)},
        {"relative_pose.stewenius", relative_pose<Central>(Central::STEWENIUS)},
        {"relative_pose.nister", relative_pose<Central>(Central::NISTER)},
        {"relative_pose.sevenpt", relative_pose<Central>(Central::SEVENPT)},
        {"relative_pose.eightpt", relative_pose<Central>(Central::EIGHTPT)},
        {"relative_pose.rotation_only", relative_pose<RotationOnlySacProblem>()},
        {"relative_pose.translation_only", relative_pose<TranslationOnlySacProblem>()},
        {"point_cloud", point_cloud},
    });
}
