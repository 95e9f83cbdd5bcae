classdef gains < handle
    % Of three axes (1x3) on one side: stiffness, damping, bias, and what the error is shrunk by: p e + d v + bias.

    properties
        p = [0 0 0]
        d = [0 0 0]
        bias = [0 0 0]
        deadband = [0 0 0]
    end

    methods

        function result = rows(self)
            % All of them (4x3).
            result = [trocar.internal.sized(self.p, 3, 'p'); trocar.internal.sized(self.d, 3, 'd'); ...
                      trocar.internal.sized(self.bias, 3, 'bias'); trocar.internal.sized(self.deadband, 3, 'deadband')];
        end

    end

end
